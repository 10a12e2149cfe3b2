"""Print jobs: job.py is the way in; stickers and page marks make marks, pdf writes them."""
