"""Image formation: camera and flat target become pixels, with blur and noise. No rig."""
