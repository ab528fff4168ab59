"""Debian's chromium without a window, and what a page did in it."""

import html
import json
import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import pytest

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("chrome")
QUIET = (
    "--headless",
    "--no-sandbox",  # it does not start as root otherwise
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
    "--enable-logging=stderr",
    "--log-level=0",
)

_WATCH = """<script>
window.faults = [];
window.addEventListener("error",
  e => window.faults.push(String(e.message || e.target.outerHTML)), true);
window.addEventListener("unhandledrejection", e => window.faults.push(String(e.reason)));
console.error = (...words) => window.faults.push(words.join(" "));
</script>"""


def need_browser() -> None:
    """Skip a test where there is no browser; in CI, where there must be one, fail it."""
    if BROWSER is None:
        reason = "no browser: apt install chromium (make browser)"
        if os.environ.get("CI"):
            pytest.fail(reason)
        pytest.skip(reason)


def drive(page: Path, script: str) -> tuple[dict[str, Any], list[str]]:
    """Open a page from disk, run an async script body in it, and return what that returns.

    Also returned: errors of the page and lines of the browser's console.
    """
    assert BROWSER is not None
    ending = f"""<script>window.addEventListener("load", async () => {{
      const told = document.createElement("pre"); told.id = "told";
      const pause = ms => new Promise(done => setTimeout(done, ms));
      let found;
      try {{ found = await (async () => {{ {script} }})(); }}
      catch (error) {{ window.faults.push(String(error.stack)); }}
      told.textContent = JSON.stringify({{found, faults: window.faults}});
      document.body.append(told);
    }});</script></body>"""
    text = page.read_text(encoding="utf-8")
    head, body = text.split("<head>", 1)
    start, last = body.rsplit("</body>", 1)
    with tempfile.TemporaryDirectory() as scratch:
        copy = Path(scratch, "page.html")
        copy.write_text(f"{head}<head>{_WATCH}{start}{ending}{last}", encoding="utf-8")
        command = [BROWSER, *QUIET, f"--user-data-dir={scratch}/profile", "--window-size=1280,1000"]
        done = subprocess.run(
            [*command, "--virtual-time-budget=20000", "--dump-dom", copy.as_uri()],
            capture_output=True,
            text=True,
            timeout=240,
        )
    match = re.search(r'<pre id="told">(.*?)</pre>', done.stdout, re.S)
    assert match, f"the page did not come to its end: {done.stderr[-2000:]}"
    told = json.loads(html.unescape(match[1]))
    console = [line for line in done.stderr.splitlines() if ":CONSOLE" in line]
    return told.get("found"), [*told["faults"], *console]
