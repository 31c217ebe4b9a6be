"""Effects: physical causes that move the end body, each a change of the mechanism's local parameters."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
