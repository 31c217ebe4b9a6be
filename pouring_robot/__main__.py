"""``python -m pouring_robot``: the same as the ``pouring-robot`` command."""

from pouring_robot.cli import main

raise SystemExit(main())
