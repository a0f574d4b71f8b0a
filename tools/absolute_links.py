"""Replace relative links of a Markdown page by absolute ones, for a page index that has no files.

python tools/absolute_links.py README.md https://host/owner/truepose v0.1.0
"""

import re
import sys
from pathlib import Path


def absolute(text: str, repository: str, version: str) -> str:
    """Return the page with links to `repository` at `version`; pictures by their raw files.

    >>> absolute("![H4](a.png) [docs](b.md#c) [web](https://d) [here](#e)", "https://r", "v1")
    '![H4](https://r/raw/v1/a.png) [docs](https://r/blob/v1/b.md#c) [web](https://d) [here](#e)'
    """

    def link(found: re.Match) -> str:
        kind = "raw" if found["picture"] else "blob"
        return f"{found['picture']}[{found['text']}]({repository}/{kind}/{version}/{found['to']})"

    relative = r"(?P<picture>!?)\[(?P<text>[^\]]*)\]\((?!https?://|#)(?P<to>[^)\s]+)\)"
    return re.sub(relative, link, text)


if __name__ == "__main__":
    page = Path(sys.argv[1])
    page.write_text(absolute(page.read_text(encoding="utf-8"), *sys.argv[2:]), encoding="utf-8")
