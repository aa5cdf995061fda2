"""2D poses of everybody in a video: a person detector, a landmark model, tracks of people, and files of the models."""
