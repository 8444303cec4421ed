"""What a person looks at: pictures and numbers of scans and volumes. No device is touched."""
