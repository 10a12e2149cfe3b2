"""What `python -m deltact_fab` runs: the command line."""

from deltact_fab.app import entry

if __name__ == "__main__":
    entry()
