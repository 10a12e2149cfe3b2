"""Position of the tip: tool lengths, touch-off, registration of the face."""
