"""What is measured for the documentation and for developers: ``python -m tests.studies NAME [options]``."""
