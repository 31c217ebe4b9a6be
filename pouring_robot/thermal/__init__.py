"""Heat: from the melt to the ladle.

``network`` finds temperatures, ``expansion`` makes them local parameters and the pose they lead to, ``regression``
predicts the ladle's error from the melt's temperature as the paper does.
"""
