"""Parts of the HTML page as text, for tests."""

from copy import copy
from html.parser import HTMLParser

from compact.report.page import answer, render_block, render_page


class PageReader(HTMLParser):
    """Start tags of a page with their attributes, and its text."""

    def __init__(self, html):
        super().__init__()
        self.tags, self.text = [], ""
        self.feed(html)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def handle_data(self, data):
        self.text += data

    def all(self, name):
        return [attributes for tag, attributes in self.tags if tag == name]

    @property
    def words(self):
        """The text with single spaces."""
        return " ".join(self.text.split())


def answer_html(study, checks=(), shifts=()):
    """HTML of question, answer and uncertainty."""
    study = copy(study)
    study.sensitivities, study.checks = list(shifts), list(checks)
    return render_page("page", sections=[], **answer(study))


def answer_words(study, checks=(), shifts=()):
    """Text of question, answer and uncertainty."""
    return PageReader(answer_html(study, checks, shifts)).words


def section_html(section):
    """HTML of the blocks of a section."""
    return "".join(render_block(block) for block in section.blocks)
