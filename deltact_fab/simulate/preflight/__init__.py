"""Predicted loads on stage and force sensor, checked before any motion."""
