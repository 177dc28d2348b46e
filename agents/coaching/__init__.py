"""A coach for exercises of the upper body: what to show, and whether a person follows.

Start at `exercise.Exercise` (what is done), `session.Session` (who is asked what) and `tree.Coach` (shows,
watches, speaks). `sources` makes frames of angles of what sensors see; `recognition` judges repetitions in
them. The task stands in `envs.coaching`, synthetic people and the page in `baselines.coaching`.
"""
