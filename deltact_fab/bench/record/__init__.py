"""A run folder: frozen inputs, an SQLite journal, images written atomically.

`docs/architecture.md` lists its files. The folder appears whole, by one rename. Rows are committed
in batches, each after its files (`journal`). A press is complete when its last step is journalled;
what else it leaves (images, truth) is on the disk before that, and the samples of a step's streams
come with its row. See docs/decisions/0005-resume.md and 0032-runner.md.
"""

from __future__ import annotations
