"""Says where the ladle of a hybrid truss pouring robot really is: closed-chain error modelling on Pinocchio.

The names that ``__init__.pyi`` lists are the library; each is imported when it is first asked for.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
