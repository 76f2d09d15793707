"""Prints the documentation, built by Sphinx as one page, as a PDF: `make pdf`.

    python docs/_ext/as_pdf.py FOLDER FILE.pdf

The folder holds what the builder ``singlehtml`` has made. A title page and the contents go before it, what
the front page says goes before the chapters, and what moves, or is for the screen, is left out.
"""

from __future__ import annotations

import sys
from pathlib import Path

from lxml import html
from lxml.builder import E

import p3dof
from p3dof._base.files import write_atomic
from p3dof.viewer.headless import pdf_of

LEFT_OUT = """//script | //dialog | //header | //footer | //iframe | //button | //a[@class='headerlink']
    | //*[contains(@class, 'sidebar') or contains(@class, 'prev-next')] | //div[@id='pst-skip-link']"""
STYLE = """
@page { size: A4; margin: 16mm 14mm 18mm; }
@media print {
  html { font-size: 10pt; }
  .bd-container, .bd-container__inner, .bd-main, .bd-content, .bd-article-container, .bd-article {
    display: block !important; max-width: none !important; width: auto !important;
    padding: 0 !important; margin: 0 !important;
  }
  body, .bd-main .bd-content .bd-article-container { max-width: none !important; }
  h2, span[id^="document-"] + section > h3, #contents + * { break-before: page; }
  section > .toctree-wrapper:first-of-type > span:first-child + section > h3 { break-before: auto; }
  h2, h3, h4, h5, h6, dt { break-after: avoid; }
  div.highlight pre { font-size: 7.5pt; white-space: pre-wrap; overflow-wrap: anywhere; overflow: visible; }
  table { font-size: 8pt; width: 100% !important; }
  td, th, td *, th * { white-space: normal !important; overflow-wrap: break-word; }
  td code *, th code *, dt code * { overflow-wrap: anywhere; }
  p, li, dd, dt { line-height: 1.35; }
  dl, dd, dd p { margin-bottom: 0.3em; }
  .pst-scrollable-table-container, .formulas, .output, .cell_output { overflow: visible !important; }
  .formulas svg { max-width: 100%; height: auto !important; }
  img { max-width: 100%; max-height: 230mm; break-inside: avoid; }
  tr, .sd-card { break-inside: avoid; }
  a { text-decoration: none !important; }
  #title { display: flex; flex-direction: column; justify-content: center; height: 240mm; }
  #title h1 { font-size: 44pt; }
  #title p { font-size: 14pt; }
  #contents { break-before: page; columns: 2; }
  #contents h1 { column-span: all; }
  #contents p { margin: 0; font-size: 8.5pt; break-inside: avoid; }
  #contents p.chapter { font-weight: bold; margin-top: 0.6em; break-after: avoid; }
}
"""


def printable(text: str) -> str:
    """Return the one page as it is to be printed."""
    page = html.fromstring(text)
    for left in page.xpath(LEFT_OUT):
        left.drop_tree()
    page.set("data-theme", "light")
    page.head.append(E.style(STYLE))
    (body,) = page.xpath("//article/section")
    (first,) = body.xpath("./h1")
    (chapters,) = body.xpath("./div[contains(@class, 'toctree-wrapper')]")
    body.append(chapters)
    first.drop_tree()
    contents = [E.h1("Contents")]
    for place in chapters.xpath(".//span[starts-with(@id, 'document-')]"):
        for heading in place.xpath("following-sibling::section[1]/*[self::h2 or self::h3]"):
            kind = "chapter" if heading.tag == "h2" else "page"
            contents.append(E.p(E.a(heading.text_content(), href=f"#{place.get('id')}"), {"class": kind}))
    said = "Inverse dynamics of parallel robots in Python"
    title = E.div(E.h1("p3dof"), E.p(said), E.p(f"Documentation of version {p3dof.__version__}"), id="title")
    body.insert(0, title)
    body.insert(1, E.div(*contents, id="contents"))
    return "<!doctype html>\n" + str(html.tostring(page, encoding="unicode"))


def main(folder: str, out: str) -> None:
    """Write the PDF, whole or not at all."""
    page = Path(folder, "printed.html")
    page.write_text(printable(Path(folder, "index.html").read_text(encoding="utf-8")), encoding="utf-8")
    write_atomic(Path(out), pdf_of(page))


if __name__ == "__main__":
    main(*sys.argv[1:])
