"""Heat: from the melt to the ladle.

``network`` finds temperatures, ``expansion`` makes them local parameters and the pose they lead to, ``regression``
predicts the ladle's error from the melt's temperature as the paper does.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
