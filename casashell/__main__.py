"""`python -m casashell` is the command line program."""

from casashell.app.startup import main

if __name__ == "__main__":
    main()
