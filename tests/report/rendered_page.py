"""A report's page as tests read it: rendered from a frame, taken apart, and its words."""

import re
from html.parser import HTMLParser
from pathlib import Path

from ravenjax.report import page
from ravenjax.report.data.runs import Runs


def rendered(frame, manifest):
    return page.render_report(Runs.of(frame, manifest), manifest, Path("out"))


class Page(HTMLParser):
    """Collects what the page would fetch, its ids and links, and whether its tags are balanced."""

    VOID = frozenset({"meta", "link", "br", "img", "input", "hr", "col"})

    def __init__(self, text):
        super().__init__()
        self.fetched, self.ids, self.targets = [], [], []
        self.stack, self.words, self.styles = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.fetched += [
            given[name] for name in ("src", "srcset", "data", "poster", "action") if name in given
        ]
        self.fetched += [given["href"]] if tag in ("link", "base") else []
        self.targets += [given["href"]] if tag == "a" else []
        self.ids += [given["id"]] if "id" in given else []
        self.styles += [given["style"]] if "style" in given else []
        if tag not in self.VOID:
            self.stack.append(tag)

    def handle_endtag(self, tag):
        assert self.stack.pop() == tag

    def handle_data(self, data):
        if not {"script", "style"} & set(self.stack):
            self.words.append(data)


def words(page):
    return re.sub("[ \n]+", " ", " ".join(page.words))
