"""One HTML file that shows what a work dir holds; opens without a server and without a network."""
