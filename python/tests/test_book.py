"""docs/check notices what is wrong in a page. That the pages are right is for docs/check itself."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from .conftest import ROOT

pytestmark = pytest.mark.skipif(not all(map(shutil.which, ("bash", "gcc", "g++"))), reason="no bash, gcc or g++")

RIGHT = """\
# A page

<!-- setup
echo 3.0 > value
-->

```console
$ cat value; echo remark >&2
3.001
$ printf 'a\\nb\\nc\\n'
a
...
$ exit 3    # exit code 3
```

```python
word = "hello"
print(word)
```

```output
hello
```

<!-- file: add.h -->
```c
int add(int a, int b);
```

```c
#include "add.h"
int add(int a, int b) { return a + b; }
```

```toml
key = 1
```

<!-- not run: needs a robot -->
```sh
robot --go
```
"""


def check(page: Path, *options: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "TROCAR_PROGRAM": os.environ.get("TROCAR_PROGRAM", sys.executable)}
    command = [sys.executable, str(ROOT / "docs" / "check"), *options, str(page)]
    return subprocess.run(command, env=environment, capture_output=True, text=True)


def test_a_right_page_passes_and_what_is_not_run_is_listed(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(RIGHT)
    ran = check(page)
    assert ran.returncode == 0, ran.stdout
    assert "page.md line 40: needs a robot" in ran.stdout


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        ("3.001", "3.1", "page.md line 8: the page shows (-)"),
        ("a\n...\n", "a\nb\n", "page.md line 10: the page shows (-)"),
        ("exit code 3", "exit code 2", "page.md line 13: exit code 3"),
        ("    # exit code 3", "", "page.md line 13: exit code 3"),
        ("```output\nhello", "```output\nhullo", "- hullo"),
        ("print(word)", "print(words)", "NameError"),
        ('#include "add.h"', '#include "sub.h"', "sub.h"),
        ("return a + b", "return a", "unused parameter"),
        ("key = 1", "key = ", "Invalid value"),
        ("<!-- not run: needs a robot -->\n", "", "exit code 127"),
        ("```toml", "```rust", "does not include this page"),
        ("```toml", "```", "a block of no language"),
        ("```toml\nkey = 1\n```", "1. item\n\n   ```sh\n   exit 4\n   ```", "exit code 4"),
    ],
)
def test_a_wrong_page_fails(tmp_path: Path, right: str, wrong: str, message: str) -> None:
    assert right in RIGHT
    page = tmp_path / "page.md"
    page.write_text(RIGHT.replace(right, wrong))
    ran = check(page)
    assert ran.returncode == 1 and message in ran.stdout, ran.stdout


def test_outputs_are_written_into_the_page(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(RIGHT.replace("3.001\n", "").replace("```output\nhello", "```output"))
    assert check(page, "--update").returncode == 0
    assert page.read_text() == RIGHT.replace("3.001", "3.0")
