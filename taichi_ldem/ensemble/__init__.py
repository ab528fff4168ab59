"""Many runs of one scene: seeds and keys varied, one process a run, here or on a cluster."""
