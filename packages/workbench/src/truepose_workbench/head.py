"""Head of the page: its own title and icon, and names of the controls for screen readers."""

import re
from html import escape
from urllib.parse import quote

_ICON = (
    "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 32 32' fill='none' stroke-width='3' "
    "stroke-linecap='round'><path stroke='#0072b2' d='M3 5h26'/>"
    "<path stroke='#009e73' d='M6 6l7 19M26 6l-7 19M16 6v12'/>"
    "<path stroke='#d55e00' stroke-width='5' d='M12 27h8'/></svg>"
)
#: viser labels numbers and handles of sliders by their place alone, and buttons by an icon.
_SCRIPT = """<script>
new MutationObserver(() => {
  for (const label of document.querySelectorAll("label[for]")) {
    const row = label.closest("div")?.parentElement;
    for (const one of row?.querySelectorAll("input, [role=slider]") ?? [])
      if (!one.labels?.length) one.setAttribute("aria-label", label.textContent);
  }
  for (const one of document.querySelectorAll("input:not([aria-label])"))
    if (!one.labels?.length) one.setAttribute("aria-label", one.placeholder || "server's address");
  for (const one of document.querySelectorAll("button:not([aria-label])")) {
    const icon = [...one.querySelector(".tabler-icon")?.classList ?? ["close"]].at(-1);
    if (!one.textContent.trim()) one.setAttribute("aria-label", icon.replace("tabler-icon-", ""));
  }
}).observe(document, {childList: true, subtree: true});
</script>"""


def own(page: str, title: str) -> str:
    """Return viser's page with the title, the icon and the script.

    Examples
    --------
    >>> page = '<link rel="icon" href="data:x"><title>Viser</title></head>'
    >>> print(own(page, "h4 & co").partition("<script>")[0][-34:])
    svg%3E"><title>h4 &amp; co</title>
    """
    icon = f'rel="icon" href="data:image/svg+xml,{quote(_ICON)}"'
    page = re.sub(r'rel="icon"\s+href="[^"]*"', lambda _: icon, page, count=1)
    titled = f"<title>{escape(title)}</title>{_SCRIPT}"
    return re.sub("<title>.*?</title>", lambda _: titled, page, count=1)
