"""Results of the sizing as files, content of summary.json and sentences: duration, work, motor, wheels and bearings."""
