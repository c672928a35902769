"""``python -m crowdsim``: the command line."""

from crowdsim.cli import main

if __name__ == "__main__":
    main()
