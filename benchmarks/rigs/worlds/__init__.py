"""The rigs as they are: physics finer than the models', with one hidden effect, and the usual imperfections besides.

Every world is a function ``(rng, size) -> World``. ``size`` is the effect's strength relative to the signal it acts on
(0: no effect).
"""
