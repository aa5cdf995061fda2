"""The stages of the pipeline: what each makes of the recording and of the stage before."""
