import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "configuration.md"


def test_the_configuration_page_is_what_the_schemas_say():
    done = subprocess.run(
        [sys.executable, "-P", "-m", "knotwork", "config", "reference"], capture_output=True, text=True, check=True
    )
    assert PAGE.read_text() == done.stdout, "run: knotwork config reference > docs/configuration.md"
