"""Results become pages, figures and tables that need no network and no script to be read."""
