"""`python -m truepose`: the command line, where its script is not on the path."""

from truepose.commands.cli import main

if __name__ == "__main__":
    main()
