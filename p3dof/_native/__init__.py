"""The compiled extension and its sources; see README.md beside this file."""
