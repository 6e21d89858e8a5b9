"""The HTML page of a study: blocks, texts and Jinja2 templates."""
