"""A local page to try a head with pictures and sentences; see `rsa-data play`."""
