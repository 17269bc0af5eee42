"""train-head: from parts of any number of datasets to one head. Start at `train_head.py`."""
