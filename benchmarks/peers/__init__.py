"""Blender's cloth and Newton's VBD beside `casashell simulate`, on results solved by casashell.

The other programs run in Pythons of their own and exchange plain npz files with the driver; nothing of
them is imported here.
"""
