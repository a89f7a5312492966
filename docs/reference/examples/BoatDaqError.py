from boat_daq import BoatDaqError, load_recording

try:
    load_recording("missing.boat")
except BoatDaqError as error:
    print(error.cause, "|", error.remedy)
