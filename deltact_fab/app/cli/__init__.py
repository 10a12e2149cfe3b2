"""The command line: one file per noun, no logic, heavy imports inside the commands."""
