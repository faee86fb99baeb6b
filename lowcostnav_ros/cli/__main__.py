"""``python -m lowcostnav_ros.cli`` is the ``lowcostnav`` command."""

import sys

from lowcostnav_ros.cli.main import main

sys.exit(main())
