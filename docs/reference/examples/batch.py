from boat_daq import batch

if __name__ == "__main__":  # it starts processes
    print(batch("recordings", workers=1)[["run", "sensor", "snr_db"]])
