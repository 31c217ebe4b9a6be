"""The paper's DH table: 32 parameters a chain, read off the URDF, and the joint placements they stand for."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
