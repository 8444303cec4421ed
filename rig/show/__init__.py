"""What a person looks at: pictures and numbers of scans and volumes. It touches no device."""
