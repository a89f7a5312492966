/* The declarations that PSoC Creator would generate for psoc_main.c, so that a test can compile it. */
#ifndef PROJECT_H
#define PROJECT_H

#include <stdint.h>

typedef uint8_t uint8;
typedef int16_t int16;
typedef uint16_t uint16;
typedef uint32_t uint32;

extern uint8 CyResetStatus;
#define CY_RESET_LVID (0x01u)
#define CY_RESET_LVIA (0x02u)
#define CY_RESET_HVIA (0x04u)
#define CY_RESET_WD (0x08u)
#define CY_RESET_SW (0x20u)
#define CyGlobalIntEnable do { } while (0)
#define CYWDT_128_TICKS (2u)
#define CYWDT_LPMODE_NOCHANGE (0u)
void CyGetUniqueId(uint32 *uniqueId);
void CyDelayUs(uint16 microseconds);
void CyWdtStart(uint8 ticks, uint8 lpMode);
void CyWdtClear(void);

#define USBUART_5V_OPERATION (2u)
#define USBUART_LINE_CONTROL_DTR (1u)
void USBUART_Start(uint8 device, uint8 mode);
uint8 USBUART_GetConfiguration(void);
uint8 USBUART_IsConfigurationChanged(void);
void USBUART_CDC_Init(void);
uint16 USBUART_GetLineControl(void);
uint8 USBUART_CDCIsReady(void);
void USBUART_PutData(const uint8 *pData, uint16 length);
uint8 USBUART_DataIsReady(void);
uint16 USBUART_GetAll(uint8 *pData);

#define ADC_WAIT_FOR_RESULT (1u)
void ADC_Start(void);
void ADC_StartConvert(void);
void ADC_StopConvert(void);
uint8 ADC_IsEndConversion(uint8 retMode);
int16 ADC_GetResult16(void);
#define Pressure_ADC_RETURN_STATUS (0u)
void Pressure_ADC_Start(void);
void Pressure_ADC_StartConvert(void);
uint8 Pressure_ADC_IsEndConversion(uint8 retMode);
int16 Pressure_ADC_GetResult16(void);
void Sensor_Mux_Start(void);
void Sensor_Mux_FastSelect(uint8 channel);
void Emitters_Write(uint8 value);
uint8 EStop_Read(void);
void Valve_Write(uint8 value);
void Clock_us_Start(void);
uint32 Clock_us_ReadCounter(void);
void Pump_Up_Start(void);
void Pump_Up_WriteCompare(uint16 compare);
void Pump_Down_Start(void);
void Pump_Down_WriteCompare(uint16 compare);

#endif
