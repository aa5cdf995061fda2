"""2D poses of all people in a video: person detector, landmark model, tracks, and files of the models."""
