"""Where the tip is: tool lengths, touch-off, registration of the face."""
