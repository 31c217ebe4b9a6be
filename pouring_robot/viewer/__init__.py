"""One scene, three outputs: a self-contained page, a picture made without a screen, a live view.

    scene = Scene("pose 3", robots=(actual, nominal), arrows=(error,), steps=(Step("", (("gap", "3.1 mm"),)),))
    write_html(scene, "view.html")
    write_png(scene, "view.png")
    with serve(scene) as view:
        view.wait()

A scene has one or more steps: a page plays them, a picture shows one.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
