"""What to command so that the actual ladle, with errors and heat, comes to the wanted pose."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
