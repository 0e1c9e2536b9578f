"""What a slider of the explorer costs, from its event to the page's new pictures: the median is printed [s].

Run as a script, so that it measures whichever revision of the package comes first on the path.
"""

import asyncio
import statistics
import time

from roslf_design.design import load
from roslf_design.explorer.session import Session

MOVES = 40


async def main() -> float:
    """Slide the FAP's diameter through other places on the view that opens first."""
    session = Session(load("paper"))
    session.opened("", "light", {})
    session.page()
    seconds = []
    for move in range(MOVES + 3):
        start = time.perf_counter()
        session.slide("D_F", 400 + move * 37 % 200, "gesture")
        session.page()
        seconds.append(time.perf_counter() - start)
    session.close()
    return statistics.median(seconds[3:])


if __name__ == "__main__":
    print(asyncio.run(main()))
