"""The command line: one file a noun, no logic, heavy imports inside the commands."""
