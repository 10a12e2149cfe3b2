"""One harness for two questions about every numerical engine.

Error against run time; and stiff and extreme cases, each right within its bound or refused.

An engine is a module in `engines` with a frozen `ENGINE`, and one line in `harness.REGISTRY`.
"""
