"""What is wrong with a scene's input, found before anything is fitted: one file for each kind of finding."""
