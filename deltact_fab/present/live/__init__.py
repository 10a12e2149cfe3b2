"""Live measurement: image sources, results, and the page that shows them."""
