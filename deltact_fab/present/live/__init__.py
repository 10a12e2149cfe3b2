"""Measuring while it happens: where images come from, and the page that shows what they say."""
