"""The pages in a real browser: Debian's chromium without a window. Without one its tests are skipped."""

import json
import shutil
import subprocess
from html.parser import HTMLParser

import pytest

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
needs_browser = pytest.mark.skipif(BROWSER is None, reason="no chromium here (Debian: apt-get install chromium)")
# No network, no sandbox (CI is root), WebGL in software.
OPTIONS = (
    *("--headless=new", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--host-resolver-rules=MAP * ~NOTFOUND", "--hide-scrollbars"),
)
# Run in the page when it is ready; what it returns stands in the page's title.
PROBE = """
<script>
const wait = setInterval(() => {
  if (!document.body.dataset.state) return;
  clearInterval(wait);
  const { viewer } = window;
  const found = { state: document.body.dataset.state };
  const seen = () => {
    viewer.render();
    const copy = document.createElement("canvas");
    copy.width = viewer.canvas.width; copy.height = viewer.canvas.height;
    const context = copy.getContext("2d");
    context.drawImage(viewer.canvas, 0, 0);
    const { data } = context.getImageData(0, 0, copy.width, copy.height);
    let drawn = 0, hash = 0;
    for (let i = 0; i < data.length; i += 4) {
      if (data[i] + data[i + 1] + data[i + 2] < 720) drawn += 1;
      hash = (hash * 31 + data[i]) % 1000003;
    }
    return { drawn: drawn / (data.length / 4), hash };
  };
  const shown = () =>
    viewer.leaves.filter(({ node }) => node.visible).map(({ node }) => node.userData.name ?? node.name);
  const mouse = { button: 0, buttons: 1, pointerId: 1, pointerType: "mouse", bubbles: true };
  const send = (type, x, y) =>
    viewer.canvas.dispatchEvent(new PointerEvent(type, { ...mouse, clientX: x, clientY: y }));
  (STEPS)(found, seen, shown, send, viewer);
  document.title = JSON.stringify(found);
}, 50);
</script></body>"""


class Title(HTMLParser):
    """Reads the text of the title."""

    def __init__(self, page):
        super().__init__()
        self.inside, self.text = False, ""
        self.feed(page)

    def handle_starttag(self, tag, attributes):
        self.inside = tag == "title"

    def handle_data(self, data):
        self.text += data if self.inside else ""


def in_browser(page, tmp_path, steps="() => {}", address="", size=(900, 500)):
    """What a page's title holds after some steps in the browser."""
    path = page.with_name(f"probe-{page.name}")  # beside it: its links lead to the same files
    path.write_text(PROBE.replace("STEPS", steps).join(page.read_text().rsplit("</body>", 1)))
    window = f"--window-size={size[0]},{size[1]}"
    command = [
        BROWSER,
        *OPTIONS,
        window,
        f"--user-data-dir={tmp_path}/profile",
        "--virtual-time-budget=200000",
        "--dump-dom",
    ]
    done = subprocess.run([*command, path.as_uri() + address], capture_output=True, text=True, timeout=120)
    title = Title(done.stdout).text
    assert title.startswith("{"), f"{done.stderr[-2000:]}\n{title}"
    return json.loads(title)
