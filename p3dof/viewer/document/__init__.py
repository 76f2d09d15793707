"""The document of the page: everything that it shows, as JSON, and the files that it is written into."""
