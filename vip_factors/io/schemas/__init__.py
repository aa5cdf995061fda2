"""Protobuf messages, generated from data_schemas by ``python data_schemas/generate.py``."""
