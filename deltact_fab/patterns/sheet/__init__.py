"""Print jobs: job.py is the way in and writes the file; stickers and page marks make marks."""
