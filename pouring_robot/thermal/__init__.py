"""Heat: from the melt's temperature to the ladle's error.

``network`` computes temperatures, ``expansion`` converts them into local parameters and the resulting pose,
``regression`` predicts the ladle's error from the melt's temperature, as the paper does.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
