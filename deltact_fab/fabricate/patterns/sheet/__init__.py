"""Print jobs: job.py is the way in and writes the file; page_marks.py makes what stands on it."""
