"""`python -m rsa_data`: the command line, where no console script is on the path."""

from .cli.main import main

if __name__ == "__main__":
    main()
