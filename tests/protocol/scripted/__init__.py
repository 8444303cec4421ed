"""Where pyserial looks for the handler of ``script://`` addresses."""
