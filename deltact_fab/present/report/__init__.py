"""Results become pages, figures and tables that open without a network."""
