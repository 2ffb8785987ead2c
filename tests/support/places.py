"""Where tests find what they read and run: the checkout and its folders."""

from pathlib import Path

SUPPORT = Path(__file__).resolve().parent
TRUTHS = SUPPORT.parent / "truths"
ROOT = SUPPORT.parents[1]
SCRIPTS = ROOT / "scripts"
EXAMPLES = ROOT / "docs" / "examples"
