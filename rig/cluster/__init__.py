"""Beyond one process: images in parts, and many scans, on the workers of a dask cluster."""
