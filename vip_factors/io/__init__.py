"""Reading and writing of files and live streams, our own and other programs'."""
