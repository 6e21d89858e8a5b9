"""Forming process: strokes of one roller over a moving mould, with mix fed before every stroke."""
