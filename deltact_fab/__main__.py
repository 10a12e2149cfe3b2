"""Entry point of `python -m deltact_fab`: the command line."""

from deltact_fab.app import entry

if __name__ == "__main__":
    entry()
