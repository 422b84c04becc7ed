"""The command line: one file for the commands of each subject; they import what they need when they run."""
