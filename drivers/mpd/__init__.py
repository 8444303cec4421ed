"""MPD (Micro Photon Devices) Fast-Gated SPAD: what it is told and says, and the detector itself."""
