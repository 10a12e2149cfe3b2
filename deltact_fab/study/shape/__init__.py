"""The paper's shapes and force distribution: presses as pure jobs, and their results."""
