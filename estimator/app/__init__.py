"""The bench in a browser: a local server and its page. Writes case files and runs commands; estimates nothing."""
