"""The paper's DH table: 32 parameters per chain, computed from the URDF, and the equivalent joint placements."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
