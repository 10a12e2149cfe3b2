"""Plans: presses chosen for a goal, with predictions that name what they rest on."""
