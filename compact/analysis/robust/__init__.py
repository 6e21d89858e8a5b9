"""Robust motion laws: the least worst peak over the drives, resistances and places of fresh mix that a plant may have.

`spring_pass` and `drive_pool` simulate one law on many elastic drives, `program` makes linear programs of their
histories, `law` searches and judges the law.
"""
