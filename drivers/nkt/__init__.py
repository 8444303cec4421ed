"""NKT Photonics SuperK supercontinuum lasers, by their register protocol."""
