"""The command `deltaph`, and `python -m deltaph`."""

import signal


def main() -> None:
    """Run the command line; Ctrl-C while it is imported, a tenth of a second, ends it without a traceback."""
    ours = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if ours:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from deltaph.cli import main as run

    if ours:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    run()


if __name__ == "__main__":
    main()
