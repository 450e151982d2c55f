"""Draws docs/euler_angles.svg, curvature weights against superposed angles.

To be run at the top of the repository: `python -m docs.euler_angles`. The fits are those of
`ocp_examples/compare_with_euler_angles.py`.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib

from docs.published import STYLE
from ocp_examples.compare_with_euler_angles import main as compare, plot

FOLDER = Path(__file__).parent


def main() -> None:
    with TemporaryDirectory() as folder:
        cases = compare(Path(folder))
    with matplotlib.rc_context(STYLE):
        plot(cases).savefig(FOLDER / "euler_angles.svg", metadata={"Date": None})


if __name__ == "__main__":
    main()
