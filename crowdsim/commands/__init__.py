"""The commands of the command line, one idea a file; heavy imports wait until a command runs."""
