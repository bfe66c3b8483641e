"""Speed of casashell, measured and compared with goals; run with ``make bench``."""
