"""Reports: content as plain data (`blocks`), which one HTML page, a PDF and the terminal each set in their own way."""
