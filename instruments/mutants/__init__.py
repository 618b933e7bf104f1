"""Do the tests notice wrong code? ``python -m instruments mutants``.

A mutant is the source with one small change. Tests kill it if one of them fails. mutmut chooses the
mutant while the program runs, by a call that compiled functions cannot make; cosmic-ray changes the
files of the working tree, and has one test command for all. So mutants are made here.
"""
