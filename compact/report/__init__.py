"""Tables, figures, text and the HTML page of results that are already computed."""
