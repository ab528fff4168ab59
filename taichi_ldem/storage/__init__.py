"""Files of a run: folder, history, fields, checkpoints."""
