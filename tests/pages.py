"""Parts of the HTML page as text, for tests."""

from copy import copy
from html.parser import HTMLParser

from compact.report.page import answer, render_page, sections


class PageReader(HTMLParser):
    """Start tags of a page with their attributes, and its text."""

    def __init__(self, html):
        super().__init__()
        self.tags, self.text = [], ""
        self.feed(html)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def handle_data(self, data):
        if self.tags and self.lasttag not in ("style", "script"):
            self.text += data

    def all(self, name):
        return [attributes for tag, attributes in self.tags if tag == name]

    @property
    def words(self):
        """The text with single spaces."""
        return " ".join(self.text.split())


def answer_words(study):
    """Text of question and answer."""
    return PageReader(render_page("page", sections=[], **answer(study, {}))).words.replace("\N{NO-BREAK SPACE}", " ")


def page_html(study, **changed):
    """HTML of the page without pictures, of a study some of whose attributes are changed."""
    study = copy(study)
    vars(study).update(changed)
    return render_page("page", sections=sections(study, {}), **answer(study, {}))
