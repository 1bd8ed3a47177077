"""What the examples share: they are called with [BUS [ROBOT]]. Anything else is answered with a usage line and exit code 2."""

import argparse
import pathlib
import sys

try:
    import sogm_swarm  # of the Debian package, or on PYTHONPATH
except ImportError:
    sys.path.append(str(pathlib.Path(__file__).resolve().parent / "../../../build/python"))  # in a checkout
    try:
        import sogm_swarm  # noqa: F401
    except ImportError:
        sys.exit("The Python package sogm_swarm is missing: install the Debian package, or in a checkout run tools/build")

from sogm_swarm.bus import ONBOARD_URL, Bus


def open_bus(description):
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("bus", metavar="BUS", nargs="?", default=ONBOARD_URL, help=f"usually {ONBOARD_URL}")
    parser.add_argument("robot", metavar="ROBOT", nargs="?", type=int, default=0, help="its number")
    arguments = parser.parse_args()
    try:
        return Bus(arguments.bus, arguments.robot)
    except ValueError as error:
        parser.error(str(error))
