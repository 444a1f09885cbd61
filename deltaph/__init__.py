"""deltaph: pick-and-place of Delta robots on Pythagorean-hodograph corners that keep a prescribed deviation."""

from importlib.metadata import version

__version__ = version("deltaph")
