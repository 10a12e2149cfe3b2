"""Trials of a plan on virtual sensors that are drawn from a population."""
