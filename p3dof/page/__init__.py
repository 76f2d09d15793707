"""One page for the browser: a document with a machine, its runs and its forces, in one file of HTML."""
