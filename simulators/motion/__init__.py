"""What moves: the steering mirror and its mount."""
