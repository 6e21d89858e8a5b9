"""The command line as a module: `python -m compact.cli`."""

from compact.cli import main

if __name__ == "__main__":
    main()
