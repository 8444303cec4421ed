"""What a person looks at: pictures of raw data and of volumes, and their numbers."""
