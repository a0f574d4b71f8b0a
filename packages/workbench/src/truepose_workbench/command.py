"""`truepose workbench`."""

import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from truepose.commands.design import parse_prices
from truepose.commands.options import completing
from truepose.exceptions import TrueposeError
from truepose.robot import list_robots, load
from truepose.show.terminal import say
from truepose_workbench.state import begin, demonstration


def command(
    robot: Annotated[
        str | None,
        typer.Argument(
            metavar="[ROBOT]",
            help="A shipped robot's name, or a robot file.",
            show_default="an H4 with one rod 3 mm too long",
            autocompletion=completing(list_robots),
        ),
    ] = None,
    price: Annotated[
        str | None,
        typer.Option(
            metavar="A=90,B*=250,reference_pose=210",
            help="Prices of sensors, names or globs, and of one-time steps: reference_pose, "
            "self_calibration.",
            show_default="the keys price and [prices] of the file",
        ),
    ] = None,
    log: Annotated[Path | None, typer.Option(help="Log file to open.")] = None,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port of the page.")] = 8080,
    host: Annotated[
        str,
        typer.Option(
            help="Address to serve on; 0.0.0.0: all addresses of this machine, for devices with "
            "the printed address."
        ),
    ] = "127.0.0.1",
    dark: Annotated[bool, typer.Option("--dark", help="Begin with a dark page.")] = False,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Serve the page without opening a browser.")
    ] = False,
) -> None:
    """Open a robot in the browser: move it, add errors, choose sensors, open a log.

    The default is an H4 with one rod 3 mm too long; one button calibrates it from its own readings.

    Example: **truepose workbench h4**
    """
    from truepose_workbench import serve  # with viser, which takes a second to load

    subject = demonstration() if robot is None else begin(load(robot))
    try:
        if not no_browser:
            webbrowser.get()
    except webbrowser.Error:
        raise TrueposeError(
            "no browser found; --no-browser serves the page for one on another machine"
        ) from None
    prices = None if price is None else parse_prices(subject.drawn, price)
    page = serve.open_page(subject, host, port, log=log, dark=dark, prices=prices)
    address = page.address("localhost" if host in ("0.0.0.0", "127.0.0.1") else host)
    say(f"{subject.drawn.name}: {address} (Ctrl-C ends it)")
    if host == "0.0.0.0" and (own := serve.own_address()):
        say(f"From other devices: {page.address(own)}")
    if not no_browser:
        webbrowser.open(address)
    serve.serve(page)
