"""Roller-compaction loads: a scene (machine, mix, motion) goes in, ranked motion laws come out."""
