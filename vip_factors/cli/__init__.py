"""The command line: ``vip-factors``, one file per command, each imported only when it is asked for."""
